"""Filters, exact second-order steps, and vectors in plain floats."""
