"""Controllers made of controllers: cascades, excitation, envelopes, and gains that follow the speed."""
