"""The input of one block adjustment, and the tests of its cameras."""
