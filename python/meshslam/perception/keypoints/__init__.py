"""Key points of cars from crops: a small network, its input and its answers."""
