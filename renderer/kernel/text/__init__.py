"""Numbers in files of text, read byte by byte."""
