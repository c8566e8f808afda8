"""Many runs: scenarios that are drawn, what is measured of each, and the processes or machines that do them."""
