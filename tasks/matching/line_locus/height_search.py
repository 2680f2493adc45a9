"""How heights are sought on a vertical line: equal steps to both sides of the start, halved until they are below what is required.

Every choice that the publication leaves open is a setting.

Source: Tumska, Procyk, Janczak (sources/line_locus.md#v1).
"""
