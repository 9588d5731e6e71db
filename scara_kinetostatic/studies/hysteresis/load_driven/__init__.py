"""Hysteresis from records driven by their load: it comes on and goes off, the response is predicted."""
