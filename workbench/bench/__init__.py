"""The research bench: named methods on the same cases with truth, judged alike."""
