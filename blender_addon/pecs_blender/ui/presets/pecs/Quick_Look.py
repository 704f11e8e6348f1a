import bpy

render = bpy.context.scene.render
pecs = bpy.context.scene.pecs

render.resolution_x, render.resolution_y, render.resolution_percentage = 320, 180, 100
pecs.chip = "imx636"
pecs.lens = "none"
pecs.bands = 3
pecs.placement = "means"
pecs.samples = 8
pecs.time = "adaptive"
pecs.fps = 1000.0
pecs.whole_range = True
pecs.sensor.model = "pecs"
pecs.sensor.readout = "chip"
pecs.sensor.noise = True
pecs.sensor.overrides.clear()
