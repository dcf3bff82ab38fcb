"""`python -m benchmarks.scale.silence`."""

from benchmarks.scale.silence import main

main()
