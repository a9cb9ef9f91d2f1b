"""Bodies on the few coordinates of a basis."""
