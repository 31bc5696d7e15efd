"""The stimuli of the paper: ids, numbers, samples. No NumPy but for samples."""
