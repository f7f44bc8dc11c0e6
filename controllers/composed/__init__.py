"""Controllers composed of controllers: cascades, excitation, envelopes, and gain scheduling with speed."""
