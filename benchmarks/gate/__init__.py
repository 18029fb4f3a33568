"""The gate: what every change of recordings, segmentation, alignment or pose is held against, on worlds of all kinds.

``make gate`` runs it: a second generator, our own simulator, real recordings where they are, and bores in CTs. What it
comes to is compared with ``record.json`` beside this file, figure by figure.
"""
