"""Training of the key point network on renders of the procedural cars; needs the extra `train` (PyTorch)."""
