"""Damaged and hostile files for every reader of endoct: each must end in one ``EndoctError``, or be read."""
