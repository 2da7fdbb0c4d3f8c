"""The driver every ablation shares: CMA-ES ask and tell, frame after frame along the clip."""
