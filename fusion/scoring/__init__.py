"""How well two sides agree, and why not better."""
