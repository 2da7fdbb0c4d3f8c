"""The driver every ablation shares: frames found one after the other, then a path through the whole clip."""
