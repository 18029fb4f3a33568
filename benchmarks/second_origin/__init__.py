"""Bores in bone, their recordings and their CT, none of it by our simulator: how well is the pose found there?

The recordings are those of :mod:`benchmarks.independent`, the bone is a segmented one or made of ellipsoids, the
scanner is this package's. Nothing here shares code with what finds a pose.
"""
