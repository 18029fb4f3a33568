"""Two panoramas of one bore: aligned, segmented and scored.

:mod:`~endoct.fusion.comparison` is the way in. It prepares each side's evidence for cells
(:mod:`~endoct.fusion.evidence`), aligns B to A (:mod:`~endoct.fusion.registration`), finds cells on each side's own
samples (:mod:`~endoct.fusion.segmentation`), brings both to one grid (:mod:`~endoct.fusion.geometry`) and scores them
(:mod:`~endoct.fusion.scoring`). What all of it found is a :class:`~endoct.fusion.result.Result`. Masks drawn by hand
come in through :mod:`~endoct.fusion.files`.
"""
