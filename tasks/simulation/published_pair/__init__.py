"""The synthetic stereopair of the published matching experiment."""
