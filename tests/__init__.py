"""The tests, as a package: dartpy installs one of this name, which workers of a cluster would find instead."""
