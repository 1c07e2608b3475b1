"""Interfaces of hmmlearn, gmr and scikit-learn over the functions of `comanip.models`, for code that has them."""
