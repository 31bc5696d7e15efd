"""Which parameters of a finger change rates and stress, from the table of a sweep."""
