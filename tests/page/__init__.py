"""The page's logic in Node.js: its modules without a browser, compared with Python."""
