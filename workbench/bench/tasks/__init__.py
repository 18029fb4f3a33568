"""The tasks of the bench: each says how its cases are made and how an answer is judged."""
