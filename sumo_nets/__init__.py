"""Road networks: the I-80 corridor (sources, built net) and lane geometry of any SUMO network as arrays."""
