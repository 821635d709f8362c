"""The operators: a correction in one go for scripts, in steps beside Blender's interface, and its end."""

import bpy

from . import panel, programs
from .correction import Correction, Failed, Render
from .exr import Unreadable
from .halves import Unfit

# Seconds between looks at what is going on.
INTERVAL = 0.1
EXPECTED = (Failed, Unfit, Unreadable, programs.NotFound, programs.ProgramFailed, OSError)
# Corrections beside the interface, to be ended when the extension goes.
AT_WORK = set()


class SSPC_OT_correct(bpy.types.Operator):
    """Render two halves with different seeds, correct the denoised picture with them, show and save it"""

    bl_idname = "sspc.correct"
    bl_label = "Render and Correct"

    animation: bpy.props.BoolProperty(name="Animation", description="All frames of the scene", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context):
        if context.scene.render.engine != "CYCLES":
            cls.poll_message_set("The scene does not render with Cycles")
            return False
        return not context.window_manager.sspc.running

    def execute(self, context):
        """In one go, for scripts and without an interface."""
        steps = None
        try:
            correction = Correction(context, self.animation)
            steps = correction.steps()
            for step in steps:
                if isinstance(step, Render):
                    rendered(bpy.ops.render.render(write_still=True))
                else:
                    programs.Program(step.command).wait()
        except (*EXPECTED, RuntimeError) as error:
            return self.end(context, "ERROR", reason(error))
        finally:
            if steps:
                steps.close()
        return self.end(context, correction.level, correction.message)

    def invoke(self, context, event):
        if bpy.app.background:
            return self.execute(context)
        try:
            self.correction = Correction(context, self.animation)
        except EXPECTED as error:
            return self.end(context, "ERROR", reason(error))
        self.steps, self.done, self.program, self.render = self.correction.steps(), 0, None, None
        state = context.window_manager.sspc
        state.running, state.cancel, state.factor, state.text, state.message = True, False, 0.0, "Starting", ""
        self.timer = context.window_manager.event_timer_add(INTERVAL, window=context.window)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set(panel.draw_status)
        bpy.app.handlers.render_complete.append(self.on_complete)
        bpy.app.handlers.render_cancel.append(self.on_cancel)
        AT_WORK.add(self)
        return {"RUNNING_MODAL"}

    # Called by Blender, from the render's thread.
    def on_complete(self, *_):
        self.render = "complete"

    def on_cancel(self, *_):
        self.render = "cancelled"

    def modal(self, context, event):
        if self not in AT_WORK:
            return {"CANCELLED"}
        state = context.window_manager.sspc
        if event.type == "ESC" and event.value == "PRESS" and self.program:
            state.cancel = True
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if self.busy(state):
                return {"PASS_THROUGH"}
            step = next(self.steps, None)
            if step is None:
                self.clean(context)
                return self.end(context, self.correction.level, self.correction.message)
            self.start(step, state)
        except Cancelled:
            self.clean(context)
            return self.end(context, "INFO", "Cancelled")
        except (*EXPECTED, RuntimeError) as error:
            self.clean(context)
            return self.end(context, "ERROR", reason(error))
        except BaseException:
            self.clean(context)
            raise
        return {"PASS_THROUGH"}

    def start(self, step, state):
        state.text, state.factor = step.text, self.done / self.correction.total
        self.done += 1
        if isinstance(step, Render):
            self.render = "running"
            if "CANCELLED" in bpy.ops.render.render("INVOKE_DEFAULT", write_still=True):
                raise Cancelled
        else:
            self.program = programs.Program(step.command)
        tag_redraw()

    def busy(self, state):
        """Whether a render or a program is still at work; raises when it was cancelled."""
        if self.render == "running" or bpy.app.is_job_running("RENDER"):
            return True
        if state.cancel or self.render == "cancelled":
            raise Cancelled
        self.render = None
        if self.program:
            if not self.program.ended():
                state.text = self.program.status or state.text
                state.factor = min(1.0, (self.done - 1 + self.program.fraction) / self.correction.total)
                tag_redraw()
                return True
            self.program = None
        return False

    def clean(self, context):
        """Stops what is at work and puts everything back."""
        AT_WORK.discard(self)
        if self.program:
            self.program.stop()
        # Here the scene gets its own settings back, and unfinished files are removed.
        self.steps.close()
        for handlers, function in (
            (bpy.app.handlers.render_complete, self.on_complete),
            (bpy.app.handlers.render_cancel, self.on_cancel),
        ):
            if function in handlers:
                handlers.remove(function)
        context.window_manager.event_timer_remove(self.timer)
        if context.workspace:
            context.workspace.status_text_set(None)
        context.window_manager.sspc.running = False
        tag_redraw()

    def cancel(self, context):
        """Blender ends the operator, e.g. because another file is opened."""
        if self in AT_WORK:
            self.clean(context)

    def end(self, context, level, message):
        """Tells how it went: to the panel, and where Blender shows reports."""
        state = context.window_manager.sspc
        state.level, state.message, state.running = level, message, False
        self.report({level}, message)
        return {"CANCELLED"} if level == "ERROR" or message == "Cancelled" else {"FINISHED"}


class SSPC_OT_cancel(bpy.types.Operator):
    """End the correction; the scene gets its settings back. A render ends with its frame, or at once with Esc"""

    bl_idname = "sspc.cancel"
    bl_label = "Cancel Correction"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return context.window_manager.sspc.running

    def execute(self, context):
        context.window_manager.sspc.cancel = True
        return {"FINISHED"}


class Cancelled(Exception):
    """The user does not want it any more."""


def reason(error):
    """What an error says, without the mark that Blender's operators put before it."""
    return str(error).strip().removeprefix("Error: ")


def rendered(result):
    if "FINISHED" not in result:
        raise Failed("Blender has not rendered the frame")


def tag_redraw():
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PROPERTIES":
                area.tag_redraw()
    # The status bar is in no screen's areas; setting its text draws it anew.
    if bpy.context.workspace and bpy.context.window_manager.sspc.running:
        bpy.context.workspace.status_text_set(panel.draw_status)


def end_all():
    """Ends every correction at work."""
    for operator in list(AT_WORK):
        operator.clean(bpy.context)


CLASSES = (SSPC_OT_correct, SSPC_OT_cancel)
