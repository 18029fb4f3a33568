"""Instruments as plug-ins: the contract, the sidecar, the registry, and the two that come with endoct."""
