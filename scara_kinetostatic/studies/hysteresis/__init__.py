"""Measured loops of load over motion: what they show beyond slope and gap."""
