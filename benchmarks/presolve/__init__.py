"""The suite `presolve`: what smaller models with the same answer gain, step by step."""
