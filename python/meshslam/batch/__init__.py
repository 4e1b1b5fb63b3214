"""Many sequences, on one machine or on several."""
