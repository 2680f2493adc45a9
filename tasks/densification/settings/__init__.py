"""The settings of the stage `densification`, without its methods."""
