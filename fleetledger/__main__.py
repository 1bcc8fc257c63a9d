"""`python -m fleetledger` is `fleetledger`."""

from fleetledger.cli import main

main()
