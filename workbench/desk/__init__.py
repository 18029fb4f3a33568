"""What `endoct open` serves: a folder of recordings, their sidecars, and a queue of endoct's own commands."""
