import bpy

render = bpy.context.scene.render
pecs = bpy.context.scene.pecs

render.resolution_x, render.resolution_y, render.resolution_percentage = 1280, 720, 100
pecs.chip = "imx636"
pecs.lens = "pecs_lab_15mm"
pecs.fnumber = 0.0
pecs.bands = 0
pecs.placement = "means"
pecs.samples = 0
pecs.time = "adaptive"
pecs.fps = 10000.0
pecs.whole_range = True
pecs.sensor.model = "pecs"
pecs.sensor.readout = "chip"
pecs.sensor.noise = True
pecs.sensor.overrides.clear()
