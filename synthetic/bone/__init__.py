"""The bone: a bore, its cells, and its wall."""
