"""The bore's wall behind the capillary."""
