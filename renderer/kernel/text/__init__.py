"""Parses numbers in text files, byte by byte."""
