"""Gains anywhere in a range, changing as they like: common Lyapunov functions, worst-case switching, safe ranges."""
