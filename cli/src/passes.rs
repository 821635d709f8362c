//! Additive passes of a frame: which are corrected, what makes denoised pictures of them, and what came of it.

use crate::denoised_passes::DenoisedPasses;
use crate::denoising::Denoising;
use crate::failure::Failure;
use clap::{Args, ValueEnum};
use serde::Serialize;
use sspc_core::correct::{BandSource, CorrectionSettings};
use sspc_core::passes::{Layout, PassRows, PassSource, SplitError, SumReport, split};
use sspc_core::tiles::ParameterSource;
use sspc_frames::error::Error;
use sspc_frames::{MadeVariant, OpenFrame, OpenPasses, OutputPlan, PassSelection};
use sspc_image::{CompactImage, Image, shown};
use std::cell::RefCell;
use std::ops::Range;
use std::time::Instant;

/// What `--passes` calls the layers that renderers name so.
const AUTO: &str = "auto";

/// Which layers are corrected beside the picture.
#[derive(Args, Clone, Debug, Default)]
pub struct PassArgs {
    /// Also correct additive passes, so that they add up to the corrected picture: light groups and lobes by the names that
    /// renderers give them (auto), or the layers of these names, in which * stands for any text
    #[arg(long, value_name = "auto|PATTERN,...", value_delimiter = ',')]
    pub passes: Option<Vec<String>>,

    /// What passes are made from before they are made to add up: their own halves, averaged as the picture's (filter), or a
    /// denoised picture of each by Open Image Denoise [default: oidn where it denoises the frame too, else filter]
    #[arg(long, value_enum, value_name = "WAY", requires = "passes")]
    pub passes_by: Option<PassesBy>,

    /// Also correct alpha, which is left as it is without
    #[arg(long)]
    pub alpha: bool,
}

/// What passes are made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PassesBy {
    /// Their halves, averaged by the picture's weights
    Filter,
    /// A denoised picture of each
    Oidn,
}

/// The passes of a frame, ready to be corrected.
pub struct FramePasses {
    open: OpenPasses,
    by: PassesBy,
    /// Of each pass, where one was made.
    denoised: Vec<Option<CompactImage>>,
    /// What they make together.
    composite: Option<MadeVariant>,
    layout: Layout,
    /// Seconds of finding and denoising.
    seconds: f64,
}

/// The corrected passes of a frame.
pub struct CorrectedPasses {
    /// In the order of [`FramePasses::output`].
    pub pictures: Vec<Image>,
    /// For reports.
    pub report: PassesReport,
}

/// What was done with passes, for reports.
#[derive(Clone, Debug, Serialize)]
pub struct PassesReport {
    /// Sets that add up to the picture.
    pub sets: Vec<SetReport>,
    /// What they were made from.
    pub by: PassesBy,
    /// Whether alpha was corrected.
    pub alpha: bool,
    /// How well they add up to the picture, as written.
    pub sum: SumReport,
    /// Wall-clock seconds, reading and denoising included.
    pub seconds: f64,
}

/// One set.
#[derive(Clone, Debug, Serialize)]
pub struct SetReport {
    /// What the passes are.
    pub what: String,
    /// Their layers.
    pub passes: Vec<String>,
    /// What of the noisy colour the noisy passes lack or have too much of beyond rounding, as a share of it.
    pub noisy_difference: f64,
}

impl PassArgs {
    fn selection(&self) -> Option<PassSelection> {
        let patterns = self.passes.as_ref()?;
        Some(match patterns.as_slice() {
            [only] if only.eq_ignore_ascii_case(AUTO) => PassSelection::Recognised,
            _ => PassSelection::Named(patterns.clone()),
        })
    }

    /// The passes of a frame whose denoised pictures are still to be made where its files do not hold them; `None` where none
    /// are asked for.
    ///
    /// # Errors
    /// Passes that are not there or do not add up, what reading can raise, no denoiser where one was asked for.
    pub fn find(&self, open: &OpenFrame, denoising: &Denoising) -> Result<Option<FramePasses>, Failure> {
        let Some((passes, by)) = self.open(open)? else { return Ok(None) };
        let begin = Instant::now();
        let denoised = match by {
            PassesBy::Filter => DenoisedPasses::default(),
            PassesBy::Oidn => denoising.passes(open, &passes)?,
        };
        Ok(Some(FramePasses::new(passes, by, denoised, begin)))
    }

    fn open(&self, open: &OpenFrame) -> Result<Option<(OpenPasses, PassesBy)>, Failure> {
        let selection = self.selection();
        if selection.is_none() && !self.alpha {
            return Ok(None);
        }
        let passes = open.passes(selection.as_ref(), self.alpha)?;
        let usual = if open.undenoised().is_some() { PassesBy::Oidn } else { PassesBy::Filter };
        Ok(Some((passes, self.passes_by.unwrap_or(usual))))
    }

    /// Says what would be corrected; the passes are looked at, and nothing is made.
    ///
    /// # Errors
    /// As [`Self::find`].
    pub fn describe(&self, open: &OpenFrame) -> Result<Vec<String>, Failure> {
        let Some((passes, by)) = self.open(open)? else { return Ok(Vec::new()) };
        Ok(FramePasses::new(passes, by, DenoisedPasses::default(), Instant::now()).lines())
    }
}

impl FramePasses {
    fn new(open: OpenPasses, by: PassesBy, denoised: DenoisedPasses, begin: Instant) -> Self {
        let sets = open.sets.iter().map(|set| set.passes.clone()).collect();
        let storage = open.passes.iter().map(|pass| pass.storage).chain(open.alpha_storage()).collect();
        let DenoisedPasses { full, composite } = denoised;
        let (layout, seconds) = (Layout { sets, storage }, begin.elapsed().as_secs_f64());
        Self { layout, open, by, denoised: full, composite, seconds }
    }

    /// What the denoised pictures of passes make together, for the frame; once.
    pub fn take_composite(&mut self) -> Option<MadeVariant> {
        self.composite.take()
    }

    /// Where the pictures go.
    ///
    /// # Errors
    /// Channels that cannot be written to.
    pub fn output(&self) -> Result<OutputPlan, Error> {
        self.open.output()
    }

    /// What was found, as lines.
    pub fn lines(&self) -> Vec<String> {
        let line = |set: &SetReport| {
            let names: Vec<String> = set.passes.iter().map(|name| shown(name)).collect();
            let difference = 100.0 * set.noisy_difference;
            format!("  passes: {} ({}; {difference:.3} % off the noisy colour)", names.join(", "), set.what)
        };
        let alpha = self.open.alpha_storage().map(|_| "  passes: alpha".to_string());
        self.sets().iter().map(line).chain(alpha).collect()
    }

    fn sets(&self) -> Vec<SetReport> {
        let of = |set: &sspc_frames::passes::OpenSet| SetReport {
            what: set.what.clone(),
            passes: self.open.passes[set.passes.clone()].iter().map(|pass| pass.name.clone()).collect(),
            noisy_difference: set.difference,
        };
        self.open.sets.iter().map(of).collect()
    }

    /// Corrects the passes of a `picture` that is finished, `[3, H, W]`, as it will be read from its file.
    ///
    /// # Errors
    /// What reading rows and the source of the parameters can raise; interruption.
    pub fn correct<B: BandSource, P: ParameterSource + ?Sized>(
        mut self,
        frame: &mut B,
        parameters: &P,
        how: &CorrectionSettings,
        picture: &Image,
        stop: &dyn Fn() -> bool,
    ) -> Result<CorrectedPasses, SplitError<B::Error, P::Error, Error>> {
        let begin = Instant::now();
        let (height, width) = (picture.height(), picture.width());
        self.denoised.resize(self.open.passes.len(), None);
        // Denoised pictures lie where the corrected ones will, band by band: memory has room for one of both.
        let has_denoised = self.denoised.iter().map(Option::is_some).collect();
        let picture_of = |denoised: Option<CompactImage>| match denoised {
            Some(denoised) => denoised.rows(0..height),
            None => Image::zeros(3, height, width),
        };
        let pictures: Vec<Image> = std::mem::take(&mut self.denoised).into_iter().map(picture_of).collect();
        let pictures = RefCell::new(pictures);
        let mut alpha = self.open.alpha_storage().map(|_| Image::zeros(1, height, width));
        let mut colours: Vec<Image> = self.open.colours.iter().map(|_| Image::zeros(3, height, width)).collect();
        let denoised = DenoisedRows { pictures: &pictures, has_denoised, before: (0..0, Vec::new()) };
        let mut source = Reader { passes: &self, colours: &mut colours, denoised };
        let sum = split(frame, parameters, how, picture, &mut source, stop, |k, top, rows| {
            match pictures.borrow_mut().get_mut(k) {
                Some(picture) => picture.put_rows(top, rows),
                None => alpha.iter_mut().for_each(|alpha| alpha.put_rows(top, rows)),
            }
        })?;
        let mut pictures = pictures.into_inner();
        let report = PassesReport {
            sets: self.sets(),
            by: self.by,
            alpha: alpha.is_some(),
            sum,
            seconds: self.seconds + begin.elapsed().as_secs_f64(),
        };
        pictures.extend(colours);
        pictures.extend(alpha);
        Ok(CorrectedPasses { pictures, report })
    }
}

/// Rows of passes for the split; their colours are kept as they are read.
struct Reader<'a> {
    passes: &'a FramePasses,
    colours: &'a mut [Image],
    denoised: DenoisedRows<'a>,
}

impl PassSource for Reader<'_> {
    type Error = Error;

    fn layout(&self) -> &Layout {
        &self.passes.layout
    }

    fn rows(&mut self, rows: Range<usize>) -> Result<Vec<PassRows>, Error> {
        let open = &self.passes.open;
        let read = open.rows(rows.clone())?;
        for (whole, colour) in self.colours.iter_mut().zip(&read.colours) {
            whole.put_rows(rows.start, colour);
        }
        let pass = |((k, halves), denoised): ((usize, [Image; 2]), Option<Image>)| PassRows {
            halves,
            colour: open.passes[k].colour.map(|at| read.colours[at].clone()),
            denoised,
        };
        let alpha = read.alpha.map(|halves| PassRows { halves, colour: None, denoised: None });
        let denoised = self.denoised.rows(rows);
        Ok(read.passes.into_iter().enumerate().zip(denoised).map(pass).chain(alpha).collect())
    }
}

/// Rows of denoised pictures that give way to the corrected ones, from the first row to the last.
struct DenoisedRows<'a> {
    /// Denoised below the rows that were put, corrected there.
    pictures: &'a RefCell<Vec<Image>>,
    has_denoised: Vec<bool>,
    /// The rows that were asked for last, as they were then: the next ones begin among them.
    before: (Range<usize>, Vec<Option<Image>>),
}

impl DenoisedRows<'_> {
    fn rows(&mut self, rows: Range<usize>) -> Vec<Option<Image>> {
        let (known, images) = &self.before;
        let pictures = self.pictures.borrow();
        let of_picture = |k: usize| {
            let (picture, known_rows) = (&pictures[k], images.get(k).and_then(Option::as_ref));
            self.has_denoised[k].then(|| {
                Image::from_rows(3, rows.len(), picture.width(), |c, y, row| {
                    let y = rows.start + y;
                    let own = match known_rows.filter(|_| known.contains(&y)) {
                        Some(image) => image.row(c, y - known.start),
                        None => picture.row(c, y),
                    };
                    row.copy_from_slice(own);
                })
            })
        };
        let found: Vec<Option<Image>> = (0..pictures.len()).map(of_picture).collect();
        self.before = (rows, found.clone());
        found
    }
}
