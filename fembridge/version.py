"""The version of fembridge."""

__version__ = "0.1.0"
