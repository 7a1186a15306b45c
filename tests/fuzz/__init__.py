"""Nothing breaks it: files, arguments and scenes that nobody would give, until the time is up.

``python -m tests.fuzz --minutes 10`` goes on where it ended. Every case follows from its kind and number alone, so that
``python -m tests.fuzz files 1234`` repeats one. A worker process with limits of memory and time runs them; outcomes are

- right: what was given is read or rendered, or refused with an error that says so;
- unclear: refused in another way: an exception of another kind, an error about a file without its name, words printed;
- wrong: samples that differ from one reading to the next, images that are not finite, a bound that does not hold;
- blow-up: memory beyond all proportion;
- hang: no end in time;
- crash: the process died.
"""
