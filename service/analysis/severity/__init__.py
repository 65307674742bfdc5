"""How severe contacts are: change of velocity and risk of injury, with probabilities by the weights of the estimate.

harm.py      from a contact and two masses to the change of velocity and the risk of injury
masses.py    what vehicles weigh, by class
objects.py   what is told of it, as JSON objects
severe.py    from examined rollouts to p(contact), p(delta-v at least v) and p(MAIS3+)
"""
