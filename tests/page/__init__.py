"""The page's logic by itself, in Node.js: its modules without a browser, against what Python says."""
