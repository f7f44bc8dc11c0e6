"""Experiments for identification: excitation signals, driven episodes, standard missions of each vehicle kind."""
