"""Reads, writes, checks and merges the files of a results folder: tables of trials, and
certificates.
"""
