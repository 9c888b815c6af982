"""What the exit codes mean; they are part of the interface and shown by --help."""

OK, FAILED, USAGE, REFUSED, INTERRUPTED = 0, 1, 2, 3, 130

TEXT = """exit codes:
  0    done (a missing peer is listed, and is no failure)
  1    run: an attempt ended in an error or a file cannot be read, its row says which;
       check: a stored claim does not hold; compare: something got slower or worse
  2    the command was not understood, or names a folder, file or scene that is not there
  3    refused: the core is a debug build, or what was asked for is not installed
  130  stopped by Ctrl-C; what was measured so far is kept, and --resume goes on"""
