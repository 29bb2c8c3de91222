"""Digests by which fitted models and heads name the network that they belong to."""

from hashlib import sha256

from semantic_slam.perception.networks.network import ClassifierNetwork, DropoutNetwork


def network_digest(classifier: ClassifierNetwork) -> str:
    """SHA-256 over weights, size of crops and the outputs that each reported class sums.

    The number of dropout passes does not matter: more of them measure the same scores.
    """
    told = f"{weights_digest(classifier.network)}:{classifier.class_names}:{classifier.members}"
    return sha256(told.encode()).hexdigest()


def weights_digest(network: DropoutNetwork) -> str:
    """SHA-256 over a network's weights and its size of crops; the layout of the weight file does not matter."""
    digest = sha256(str(network.input_size).encode())
    for name, tensor in sorted(network.state_dict().items()):
        digest.update(f"{name}:{tuple(tensor.shape)}".encode())
        digest.update(tensor.contiguous().numpy().tobytes())
    return digest.hexdigest()
