"""Tests of the Python package."""

import signal

# A shell makes programs in the background ignore Ctrl-C; some tests press it, and would wait for ever.
signal.signal(signal.SIGINT, signal.default_int_handler)
