"""Untrusted bytes read in a process of their own, with limits of memory, time and output.

Libraries that unpack, or that reserve memory by what a file claims (pyarrow, rosbags, python-can), may loop for ever,
need all memory or crash on a damaged or hostile file. Here that ends their process and nothing else, and becomes one
sentence. :mod:`analysis.confined.call` is the parent's side, :mod:`analysis.confined.process` the child's.

This is a limit of resources, not a sandbox: the process may do whatever its user may.
"""
