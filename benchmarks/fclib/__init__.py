"""The suite `fclib`: problem files of the FCLIB format, or problems of our own, by every solver at several tolerances.

Success is what the certificate of the impulses says against the exact Coulomb law of the file; no solver is believed.
"""
