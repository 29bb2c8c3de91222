"""Chapter 5: continuous semantics in a learned latent space, P(f(z) | x_rel, e)."""
