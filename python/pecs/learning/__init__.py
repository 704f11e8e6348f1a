"""Video from events: recurrent networks, their training on data sets of `pecs.datasets`, and a filter without weights.

    pecs reconstruct recording.raw -o video.mp4
    pecs train SET -o RUN
    pecs reconstruct recording.raw -o video.mp4 --weights RUN/network.onnx

`filter`, `video` and `reconstruct` need no PyTorch; `networks`, `losses`, `clips` and `train` do.
"""
