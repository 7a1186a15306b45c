"""Speed and accuracy of wvr, measured: ``python -m benchmarks``. Needs the ``dev`` extra."""
