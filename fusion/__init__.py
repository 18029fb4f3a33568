"""Two panoramas of one bore: aligned, segmented and scored.

:mod:`~endoct.fusion.comparison` is the way in. It takes these steps:

1. It prepares each side's evidence for cells (:mod:`~endoct.fusion.evidence`).
2. It aligns B to A (:mod:`~endoct.fusion.registration`).
3. It finds cells on each side's own samples (:mod:`~endoct.fusion.segmentation`).
4. It brings both to one grid (:mod:`~endoct.fusion.geometry`).
5. It scores them (:mod:`~endoct.fusion.scoring`).

What all of it found is a :class:`~endoct.fusion.result.Result`. Masks drawn by hand come in through
:mod:`~endoct.fusion.files`.
"""
