"""Gains from a policy: the closed loop's Jacobian, what it can hold, growing motions, regions of attraction."""
