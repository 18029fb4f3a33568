"""Two panoramas of one bore: aligned, segmented and scored.

:mod:`~endoct.fusion.comparison` is the way in. It prepares each side's evidence for cells
(:mod:`~endoct.fusion.prepare`), aligns B to A (:mod:`~endoct.fusion.alignment`), finds cells on each side's own
samples (:mod:`~endoct.fusion.cells`), brings both to one grid (:mod:`~endoct.fusion.placement`) and counts how they
agree (:mod:`~endoct.fusion.scores`). Masks drawn by hand come in through :mod:`~endoct.fusion.masks`.
"""
