"""Tests of the page's logic in Node.js: its modules without a browser, against Python."""
