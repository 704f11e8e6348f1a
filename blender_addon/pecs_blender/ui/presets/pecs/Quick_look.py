import bpy

render = bpy.context.scene.render
pecs = bpy.context.scene.pecs

render.resolution_x, render.resolution_y, render.resolution_percentage = 320, 180, 100
pecs.bands = 3
pecs.placement = "means"
pecs.samples = 4
pecs.time = "uniform"
pecs.fps = 1000.0
pecs.frames = 100
pecs.whole_range = False
pecs.sensor.model = "pecs"
