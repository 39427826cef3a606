"""Gains against an environment: filters, delay and flexible joints in contact, and the passivity of a port."""
