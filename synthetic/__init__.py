"""A renderer of bores, air cells and the recordings that both instruments make of them, with truth.

It shares no image formation with the plug-ins that undo it.
"""
