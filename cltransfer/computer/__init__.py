"""What the computer has and how it is used: memory, threads, CUDA, packages, compiled kernels."""
