/**
 * What the service says, as far as the page reads it. The reference is /openapi.json.
 *
 * @typedef {[number, number, number]} Vec3
 *
 * @typedef {object} View world space, lengths in the scene's unit
 * @property {Vec3} eye
 * @property {Vec3} target
 * @property {Vec3} up
 * @property {number} fov vertical, in degrees
 * @property {string} [projection] perspective where it is left out
 * @property {number} [aperture] radius of the lens; 0: all is sharp
 * @property {number | null} [focus] distance of what is sharp along the line of sight; null: the target's
 * @property {number} [near] what stands before this distance is cut away
 * @property {number} [shift_x] of the lens, to the right, in heights of the picture
 * @property {number} [shift_y] up
 * @property {number} [height] what an orthographic camera shows from top to bottom
 *
 * @typedef {{name: string, view: View}} Camera
 *
 * @typedef {object} Scene
 * @property {string} id
 * @property {string} name
 * @property {string} [project] whose members see it; empty: none
 * @property {"preparing" | "ready" | "failed"} status
 * @property {string | null} error
 * @property {string | null} step what preparing does at the moment
 * @property {number | null} progress of preparing, 0..1
 * @property {number} created unix seconds
 * @property {number} bytes
 * @property {string | null} thumbnail its address
 * @property {Camera[]} cameras the last one frames the whole scene
 * @property {Record<string, number>} counts
 * @property {number[][] | null} bounds lower and upper corner
 * @property {string[]} [variants] of a glTF file's materials
 * @property {string | null} [variant] the one that is shown; null: the file's own
 * @property {string | null} [environment] in place of its own: an image among its files, or sky:ELEVATION,AZIMUTH
 * @property {Clip[]} [clips] of its animations
 * @property {number | null} [fps] the file's own, else 24
 * @property {{sample_s: number, noise: number | null} | null} [measured] by its latest picture: seconds of a slot for a sample
 *     of a pixel, and the relative noise at one sample
 * @property {string[]} warnings
 * @property {boolean} [strict] whether warnings fail it
 * @property {Record<string, any>} defaults settings that the scene file asks for
 *
 * @typedef {{name: string, start: number, end: number}} Clip from when to when it moves, in seconds
 *
 * @typedef {SettingsTable & {formats: string[], foreign: Record<string, string>}} Info what this farm takes; formats: suffixes
 *     of what may be uploaded; foreign: of what may not, and how to get out of it what may
 *
 * @typedef {"queued" | "running" | "paused" | "finished" | "failed" | "cancelled"} JobState
 *
 * @typedef {object} Job
 * @property {string} id
 * @property {string} name
 * @property {string} scene
 * @property {string} [project] its scene's; empty: none
 * @property {JobState} state
 * @property {string | null} message why it does not go on at the moment
 * @property {boolean} [stranded] none of the workers is of the kind that began it
 * @property {string | null} error
 * @property {string | null} reproduce a command that shows the error again
 * @property {number} progress 0..1
 * @property {number | null} eta_s
 * @property {number} active_s time spent on rendering, pauses left out
 * @property {number} samples in the film: every pixel of every frame counted
 * @property {number} samples_per_s of the moment; 0 where it is not being rendered
 * @property {number} bad_samples that were NaN or infinite, and left out
 * @property {Frame[]} [frames] the only one of a still, the first of a shot
 * @property {Shot | null} [shot] null: a still
 * @property {number} priority -100 to 100
 * @property {number} created unix seconds
 * @property {number | null} [finished] likewise
 * @property {number | null} width null until the scene is ready, where the request leaves it to the scene
 * @property {number | null} height
 * @property {number | null} spp at most
 * @property {number | null} noise
 * @property {number | null} seconds
 * @property {number | null} [tile_size]
 * @property {[number, number, number, number] | null} [focus] the rectangle that is rendered first: x, y, w, h
 * @property {Record<string, any> | null} settings
 * @property {EnvironmentRequest | null} [environment] as it was asked for
 * @property {string | null} [variant] as it was asked for
 * @property {boolean} [pinned] kept, whatever its age
 * @property {string | null} [note] what somebody wrote about it
 * @property {string | null} [user] who asked for it
 * @property {number | null} [max_slots] that render it at a time, at most
 * @property {string[]} [needs] of the workers that render it
 * @property {number | null} [deadline] by when it is wanted, unix seconds
 * @property {number | null} [expected] when it is to be ready by the forecast, where it has a deadline
 * @property {string | null} [unforeseen] why there is no forecast
 * @property {number | null} [late] since when it is expected to miss that
 * @property {Wait[]} [waits_for] the jobs that it comes after and that are not finished
 * @property {string[]} [doubted] workers that were found out since, and whose samples its picture holds
 * @property {{job: string, spp: number, samples?: number | null, frames?: string | null} | null} [taken] with what of an earlier
 *     one of the same picture it began; frames: of a shot, those that it took
 *
 * @typedef {{id: string, name: string | null, state: JobState | null}} Wait name and state: null where it was deleted
 *
 * @typedef {"queued" | "preparing" | "running" | "finished" | "failed"} FrameState
 *
 * @typedef {object} Frame one picture of a job
 * @property {number} number in steps of a half
 * @property {FrameState} state
 * @property {number} samples all pixels together
 * @property {number} spp a pixel, on the average
 * @property {number} progress 0..1
 * @property {number | null} noise relative
 * @property {string | null} error
 * @property {{x: number, y: number, sample: number, reproduce?: string}[]} [bad] the first samples that were left out
 *
 * @typedef {object} Shot
 * @property {string} frames which there are, as 0-99,120
 * @property {number} count
 * @property {number | null} fps null: the scene file's own, else 24
 * @property {string | null} clip
 * @property {number | null} turntable seconds
 * @property {string} order
 * @property {number} every
 * @property {number | null} first the frame that goes before all others
 * @property {Partial<Record<FrameState, number>>} states how many frames are so
 * @property {string} failed which
 * @property {number | null} noise the greatest of its frames
 * @property {number | null} forecast
 *
 * @typedef {object} EnvironmentRequest
 * @property {number} [strength]
 * @property {number} [rotation] degrees
 * @property {Vec3} [color] linear Rec.709
 * @property {{elevation: number, azimuth?: number}} [sky] degrees
 * @property {string} [preset] by name
 * @property {string} [image] an uploaded one's id
 * @property {string | null} [name] what that is called
 *
 * @typedef {object} Environment light that can be chosen
 * @property {string} id
 * @property {string} name
 * @property {string} help
 * @property {"preset" | "image"} kind
 * @property {EnvironmentRequest} environment what to ask for it by
 * @property {string} thumbnail its address
 *
 * @typedef {object} Reference a picture that was uploaded to compare with
 * @property {string} id
 * @property {string} name
 * @property {number} created unix seconds
 * @property {number} bytes
 * @property {number} width
 * @property {number} height
 * @property {boolean} display_referred 8 bits a channel, as a screen shows it
 * @property {number} clipped pixels whose values were cut off
 *
 * @typedef {object} Snapshot what a job looked like on its way
 * @property {number} spp that every tile had, or was complete with fewer
 * @property {number} least samples a pixel of the tile that had fewest then
 * @property {number} most
 * @property {number} samples of all pixels together
 * @property {number} seconds of rendering until then
 * @property {number | null} noise relative
 *
 * @typedef {Record<string, any> & Asked} JobRequest and whichever of the settings: the scene file's own where one is left out
 *
 * @typedef {object} Asked
 * @property {string} scene
 * @property {string} [variant] by number; empty: the file's own materials
 * @property {string | number} [camera] by its name, or by its number
 * @property {View} [view]
 * @property {string} [name]
 * @property {number} [priority]
 * @property {number} [width]
 * @property {number} [height]
 * @property {number} [spp]
 * @property {number} [noise] relative
 * @property {number} [seconds]
 * @property {EnvironmentRequest} [environment] in place of the scene's own, or times its strength
 * @property {number} [frame] a still of that moment
 * @property {string} [frames] of a shot
 * @property {boolean} [fresh] from the first sample, whatever earlier jobs have
 * @property {string | null} [deadline] by when it is wanted: an ISO time
 * @property {number | null} [max_slots] that render it at a time, at most
 * @property {string[]} [needs] of the workers that render it
 * @property {string[]} [after] jobs, by their ids
 * @property {number} [verify] the share of its batches that is rendered twice
 *
 * @typedef {object} Worker
 * @property {string} name
 * @property {number} slots
 * @property {string} state
 * @property {string} cpu
 * @property {number} samples_per_s of one slot
 * @property {boolean} [denoises]
 * @property {Record<string, any>[]} current a slot each
 * @property {string | null} [message] why it is paused
 * @property {number | null} [memory_used] bytes
 * @property {number | null} [memory_total]
 * @property {number} [failures] of batches
 * @property {Offer | null} [offer] null: it is of an older release, and can only be paused
 * @property {number[]} [speeds] samples a second of all its slots, a minute each
 *
 * @typedef {object} Offer what a worker offers
 * @property {string[]} tags
 * @property {number} memory bytes that it may use
 * @property {number} slots_most it was started with so many
 * @property {string} hours empty: always
 * @property {number} idle_minutes
 * @property {string[]} idle_by how it knows that somebody works at its machine
 * @property {number} nice
 * @property {number} memory_limit bytes; 0: none
 * @property {string | null} rests why it takes nothing at the moment, by its own hours or limits
 * @property {string | null} trouble what was asked of it and it cannot do
 *
 * @typedef {{name: string, label: string, help: string}} Choice
 *
 * @typedef {object} Setting
 * @property {string} name
 * @property {string} label
 * @property {string} help a sentence
 * @property {"integer" | "number" | "choice" | "color" | "vector"} type
 * @property {any} default null where there is none
 * @property {number | null} minimum
 * @property {number | null} maximum
 * @property {{value: number | null, label: string} | null} off the value that switches it off, and what that is called
 * @property {"" | "px" | "°" | "s" | "fraction" | "scene units" | "radiance"} unit
 * @property {Choice[] | null} choices
 * @property {"basic" | "advanced" | "lab"} group
 * @property {string} section what it stands beside
 * @property {"job" | "environment"} of what of a request it belongs to
 * @property {string[] | null} integrators that look at it; null: all
 * @property {string[] | null} projections that look at it; null: all
 * @property {[number, number] | null} [usual] the range that people use, for a slider
 * @property {string} phrase names a picture by the value, in place of {}
 *
 * @typedef {object} Channel
 * @property {string} name "" for the light as it is; else the service's name of the plane, or DENOISED
 * @property {string} label
 * @property {string} help
 * @property {string[]} values the names of a pixel's numbers
 *
 * @typedef {{settings: Setting[], view: Setting[], work: Setting[], shot: Setting[], channels: Channel[]}} SettingsTable
 *
 * @typedef {{name: string, title: string, description: string, frames: string | null, fps: number | null}} Example
 *
 * @typedef {[number, number, number]} Spot x, y, w: seen at x / w, y / w of the picture where w is above 0
 *
 * @typedef {object} PathVertex as the API's PathVertexOut
 * @property {"surface" | "passed" | "medium" | "missed"} kind
 * @property {string | null} object_name
 * @property {number | null} object
 * @property {string | null} material_name
 * @property {number | null} material
 * @property {string | null} model
 * @property {"reflected" | "transmitted" | null} bounce
 * @property {number | null} pdf
 * @property {number | null} survival
 * @property {number | null} distance
 * @property {number[] | null} point
 * @property {number[]} throughput
 * @property {number[]} emitted
 * @property {number[]} beside
 * @property {number | null} emitted_weight
 * @property {number[]} direct
 * @property {{point: number[] | null, pdf: number | null, weight: number, brought: number[], spot: Spot} | null} light
 * @property {Spot} spot
 *
 * @typedef {{chosen: string[], sample: number, value: number[] | null, end: string | null, vertices: PathVertex[]}} PixelPath
 *
 * @typedef {{x: number, y: number, frame: number, samples: number, mean: number[] | null, equals_film: boolean | null, worker: string | null, paths: PixelPath[]}} Explained
 *
 * @typedef {Record<string, number | number[] | string | null> & {samples: number}} PixelValue by channel, `color` being the light
 */

export {};
