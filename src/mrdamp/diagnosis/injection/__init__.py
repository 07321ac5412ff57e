"""Fault injection: a known effect of the catalogue is inserted exactly into measured records and diagnosed.
"""
