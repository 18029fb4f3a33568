"""Two panoramas of one bore: aligned, segmented and scored.

:mod:`~endoct.fusion.comparison` is the way in. It prepares each side's evidence for cells
(:mod:`~endoct.fusion.prepare`), aligns B to A (:mod:`~endoct.fusion.alignment`), finds cells on each side's own
samples (:mod:`~endoct.fusion.cells`), brings both to one grid (:mod:`~endoct.fusion.placement`) and scores them
(:mod:`~endoct.fusion.scoring`): overlap (:mod:`~endoct.fusion.scores`), outlines (:mod:`~endoct.fusion.boundary`),
cells as objects (:mod:`~endoct.fusion.objects`), and what of the disagreement has which cause
(:mod:`~endoct.fusion.budget`). Masks drawn by hand come in through :mod:`~endoct.fusion.masks`, how raters agree is in
:mod:`~endoct.fusion.raters`.
"""
