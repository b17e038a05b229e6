"""Parsing of numbers in text files, byte by byte."""
