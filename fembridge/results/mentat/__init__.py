"""What Marc and Mentat leave beside a post file: ``.sts``, plots as text, ``.h5``."""
