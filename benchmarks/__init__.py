"""Speed and accuracy of what the project claims, as ratios measured in one run: `make bench`."""
