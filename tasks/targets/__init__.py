"""Signalised targets in photographs: found by themselves, with sub-pixel centres and their standard errors."""
