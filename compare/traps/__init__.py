"""Calls that people reach for and that are wrong without a word, one file a library."""
