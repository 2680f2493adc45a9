"""Where the results of a run are kept: a folder of this machine's disk, or a prefix of an object store; everything else sees bytes
by name."""
