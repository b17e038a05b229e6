"""The path tracer for pictures, many paths at once: a pool of paths in rows, and stages that take eight of them at a time.

A stage goes through a list of rows' numbers (lists.py); which rows stand beside each other leaves no trace in a sample, whose
numbers follow from its pixel and its own number alone. trace.py is the driver.
"""
