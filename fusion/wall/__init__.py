"""One wall of two aligned sides: its cells, its relief, and where both are sure and contradict each other."""
