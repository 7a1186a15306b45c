"""``python -m benchmarks gpu``: all that is to be known of a GPU, in one command that ends in time.

Whether images are those of the CPU and true, how long frames take, what limits them, and the papers' tables. On the CPU
(``--device cpu``) it rehearses itself, casting rays as a GPU would: one a work item, without vectors.
"""
