"""The suite `impacts`: what each impact law makes of collisions whose answers are known, or whose balance is."""
