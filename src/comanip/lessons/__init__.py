"""Recordings become demonstrations, and what can be wrong with them is said."""
