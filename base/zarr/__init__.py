"""Zarr stores, checked before their library sees them."""
