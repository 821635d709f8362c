"""The panel in Output properties, and the status bar while a correction is at work."""

import textwrap

import bpy

# Pixels that a character of the message takes on average, and that margins and the icon take, at the usual scale.
CHARACTER, MARGINS = 6.5, 60
# Characters, also where there is no panel to measure.
SHORTEST_LINE = 20
# Of the progress in the status bar, in Blender's units: room for its text.
STATUS_WIDTH = 24
ICONS = {"INFO": "CHECKMARK", "WARNING": "ERROR", "ERROR": "CANCEL"}


class SSPC_PT_output(bpy.types.Panel):
    bl_label = "Post-Correction"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "output"
    bl_options = {"DEFAULT_CLOSED"}
    COMPAT_ENGINES = {"CYCLES"}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        layout, settings, state = self.layout, context.scene.sspc, context.window_manager.sspc
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in ("preset", "seed", "split", "strength", "fit_frames", "save", "folder", "keep"):
            layout.prop(settings, name)
        if state.running:
            draw_progress(layout, state, state.text)
            return
        # One below the other: the editor is narrow as Blender opens it.
        column = layout.column(align=True)
        column.operator("sspc.correct", text="Correct Frame", icon="RENDER_STILL").animation = False
        column.operator("sspc.correct", text="Correct Animation", icon="RENDER_ANIMATION").animation = True
        lines = textwrap.wrap(state.message, line_length(context))
        column = layout.column(align=True)
        column.scale_y = 0.8
        for at, line in enumerate(lines):
            column.label(text=line, icon=ICONS.get(state.level, "NONE") if at == 0 else "BLANK1")


def line_length(context):
    """Characters of the message that fit into the width of the panel."""
    if not context.region:
        return SHORTEST_LINE
    width = context.region.width / context.preferences.system.ui_scale
    return max(SHORTEST_LINE, int((width - MARGINS) / CHARACTER))


def draw_progress(layout, state, text):
    row = layout.row(align=True)
    row.progress(factor=state.factor, text=text)
    row.operator("sspc.cancel", text="", icon="CANCEL")


def draw_status(header, context):
    """In place of the status bar's own content."""
    row, state = header.layout.row(), context.window_manager.sspc
    row.ui_units_x = STATUS_WIDTH
    draw_progress(row, state, f"Post-correction: {state.text}")


CLASSES = (SSPC_PT_output,)
