"""Measurements that back the figures in the documentation; one module, one command each."""
