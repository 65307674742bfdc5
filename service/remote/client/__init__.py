"""A typed client of a fleet:

    from service.remote.client import Client

    with Client("tcp/127.0.0.1:7447") as fleet:
        job = fleet.submit("i80-10s", gamma=0.0, ego="lidar", budget=20_000)
        for event in fleet.watch(job.id):
            print(event.kind, event.body)
        print(fleet.estimate(job.id).p)

Methods return the types of `service.remote.api.objects`; what the service refuses is raised as `Refused`, with the
problem details it gave.
"""

from service.remote.client.client import DEFAULT_ENDPOINT, Client
from service.remote.client.errors import NoAnswer, Refused

__all__ = ["DEFAULT_ENDPOINT", "Client", "NoAnswer", "Refused"]
