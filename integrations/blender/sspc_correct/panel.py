"""The panel in Output properties, and the status bar while a correction is at work."""

import textwrap

import bpy

# Characters of a line of the message.
LINE = 60
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
            draw_progress(layout, state)
            return
        row = layout.row(align=True)
        row.operator("sspc.correct", text="Correct Frame", icon="RENDER_STILL").animation = False
        row.operator("sspc.correct", text="Correct Animation", icon="RENDER_ANIMATION").animation = True
        lines = textwrap.wrap(state.message, LINE)
        column = layout.column(align=True)
        for at, line in enumerate(lines):
            column.label(text=line, icon=ICONS.get(state.level, "NONE") if at == 0 else "BLANK1")


def draw_progress(layout, state):
    row = layout.row(align=True)
    row.progress(factor=state.factor, text=f"Post-correction: {state.text}")
    row.operator("sspc.cancel", text="", icon="CANCEL")


def draw_status(header, context):
    """In place of the status bar's own content."""
    draw_progress(header.layout, context.window_manager.sspc)


CLASSES = (SSPC_PT_output,)
