"""Training of the shipped networks (needs the extra `train`); nothing else imports this package."""
