"""A renderer of bores, air cells and the recordings that both instruments make of them, with truth.

It shares no image formation with the plug-ins that undo it. Left out so far, because they need a more
physical renderer: that the capillary's glass bends oblique beams (by up to about 1.5° where the catheter is far
off axis), cells that undercut the wall or hold fluid, light that is reflected twice, a tilted probe, A-scans
that get lost.
"""
