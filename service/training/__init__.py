"""Training of the shipped networks (needs the extra `train`): scripts above everything else, which nothing imports."""
