"""Loads: dead and follower loads, foundations and contact."""
