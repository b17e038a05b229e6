"""Path guides: `train.py` follows pilot paths, and `histograms.py` makes the guide from what they record."""
