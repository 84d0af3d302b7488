"""Adam (Kingma & Ba, 2015) on one network of all seeds; it works by element, so the seeds stay apart."""

import torch
from torch import Tensor

from maglev_offline.agents.networks import STATISTICS, Network

BETA_1, BETA_2, EPS = 0.9, 0.999, 1e-8


class Adam:
    """Moments of the gradients, by the names of the network's parameters, and the number of steps taken.

        m <- b1 m + (1 - b1) g,   v <- b2 v + (1 - b2) g^2
        theta <- theta - learning_rate  m / (1 - b1^t)  / (sqrt(v / (1 - b2^t)) + eps)

    torch's own class does the same, at several times the cost where the tensors are as small as these.
    """

    def __init__(self, net: Network, learning_rate: float) -> None:
        self.parameters = {name: value for name, value in net.items() if name not in STATISTICS}
        self.mean = {name: torch.zeros_like(value) for name, value in self.parameters.items()}
        self.square = {name: torch.zeros_like(value) for name, value in self.parameters.items()}
        self.steps = torch.zeros((), device=next(iter(self.parameters.values())).device)
        self.learning_rate = learning_rate

    def descend(self, loss: Tensor) -> None:
        """One step down the loss in the parameters of this network, and of no other."""
        parameters = list(self.parameters.values())
        gradients = torch.autograd.grad(loss, parameters)
        self.steps += 1
        with torch.no_grad():
            torch._fused_adam_(
                parameters,
                gradients,
                list(self.mean.values()),
                list(self.square.values()),
                [],
                [self.steps] * len(parameters),
                lr=self.learning_rate,
                beta1=BETA_1,
                beta2=BETA_2,
                weight_decay=0.0,
                eps=EPS,
                amsgrad=False,
                maximize=False,
            )
