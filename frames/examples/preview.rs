//! Shows an OpenEXR picture as PNG through the preview's tone curve.
//!
//!     cargo run --release -p sspc-frames --example preview -- IN.exr OUT.png [EXPOSURE]

use sspc_frames::{preview, read_picture};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (Some(input), Some(output)) = (arguments.first(), arguments.get(1)) else {
        return Err("expected IN.exr OUT.png [EXPOSURE]".into());
    };
    let picture = read_picture(input.as_ref(), None)?;
    let exposure = match arguments.get(2) {
        Some(text) => text.parse()?,
        None => preview::auto_exposure(&picture),
    };
    preview::write_png(output.as_ref(), &[input.into()], &preview::tone_map(&picture, exposure))?;
    Ok(())
}
