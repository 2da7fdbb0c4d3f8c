"""What runs and on what: memory, threads, CUDA, machine code of kernels, which packages and which commit."""
