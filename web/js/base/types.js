/**
 * Types of the service's messages, as far as the page reads them. The reference is /openapi.json.
 *
 * @typedef {[number, number, number]} Vec3
 *
 * @typedef {object} View world space, lengths in the scene's unit
 * @property {Vec3} eye
 * @property {Vec3} target
 * @property {Vec3} up
 * @property {number} fov vertical, in degrees
 * @property {string} [projection] perspective if left out
 * @property {number} [aperture] radius of the lens; 0: pinhole
 * @property {number | null} [focus] focus distance along the line of sight; null: the target's
 * @property {number} [near] near clipping distance
 * @property {number} [shift_x] lens shift to the right, in picture heights
 * @property {number} [shift_y] lens shift up
 * @property {number} [height] visible height of an orthographic camera
 *
 * @typedef {{name: string, view: View, sees_nothing?: boolean}} Camera
 *
 * @typedef {Record<string, any>} Codes of texts by field: code and params of each, see said.js
 *
 * @typedef {object} Scene
 * @property {Codes} [codes]
 * @property {string} id
 * @property {string} name
 * @property {string} [project] the project it belongs to; empty: none
 * @property {"preparing" | "ready" | "failed"} status
 * @property {string | null} error
 * @property {string | null} step current step of its preparation
 * @property {number | null} progress of preparing, 0..1
 * @property {number} created unix seconds
 * @property {number} bytes
 * @property {string} [main] path of the file that is read first
 * @property {{path: string, size: number}[]} [files] what was uploaded
 * @property {string | null} thumbnail URL
 * @property {string | null} [poster] URL of a sharp picture of the view that its page opens with
 * @property {string | null} [preview] URL of a mesh; while the scene is prepared it comes with cameras, bounds and defaults
 * @property {Camera[]} cameras the last one frames the whole scene
 * @property {Record<string, number>} counts
 * @property {number[][] | null} bounds lower and upper corner
 * @property {string[]} [variants] of a glTF file's materials
 * @property {string[]} [light_groups] names of its lights' groups
 * @property {string | null} [variant] selected variant; null: the file's own
 * @property {string | null} [up_axis] the axis of its file that is up, where its format states none
 * @property {string | null} [up] the requested up axis; null: guessed
 * @property {"on" | "auto" | null} [floor] whether it gets one: "auto" if it has no lights
 * @property {boolean} [has_floor] whether the studio's floor lies below it
 * @property {string | null} [environment] replaces its own light: an image among its files, or sky:ELEVATION,AZIMUTH
 * @property {Clip[]} [clips] of its animations
 * @property {number | null} [fps] the file's own, else 24
 * @property {{sample_s: number, noise: number | null, pace?: number | null, denoise_s?: number | null} | null} [measured] by its latest picture: seconds of a slot for a sample
 *     of a pixel, and the relative noise at one sample
 * @property {string[]} warnings
 * @property {boolean} [strict] whether warnings fail it
 * @property {Record<string, any>} defaults settings that the scene file asks for
 *
 * @typedef {{name: string, start: number, end: number}} Clip start and end of the animation, in seconds
 *
 * @typedef {SettingsTable & {formats: string[], foreign: Record<string, string>, foreign_codes?: Codes}} Info what this farm takes; formats: suffixes
 *     of what may be uploaded; foreign: of what may not, and how to get out of it what may
 *
 * @typedef {object} Joining commands for a POSIX shell with which workers join this farm
 * @property {string | null} url for other machines; null: the settings name none
 * @property {string | null} start starts the farm for other machines; null: they reach it, or it is unknown
 * @property {string} token run on the farm's machine: writes a new worker's token to NAME.token
 * @property {string} here run on the farm's machine: starts a worker there
 * @property {string} program on other machines
 *
 * @typedef {"queued" | "running" | "paused" | "finished" | "failed" | "cancelled"} JobState
 *
 * @typedef {object} Review
 * @property {"approved" | "changes-requested" | null} state null: no verdict
 * @property {string | null} by who gave it
 * @property {boolean} guest whether that was a guest of a share link
 * @property {number | null} at unix seconds
 * @property {number} notes number of notes and replies
 * @property {number} open number of notes that are not resolved
 * @property {number} changed unix seconds of the latest change
 *
 * @typedef {object} Note a note on a picture, or a reply to one
 * @property {string} id
 * @property {string | null} reply_to the note that it answers
 * @property {number} frame
 * @property {number | null} x fraction of the picture's width; null: the whole picture
 * @property {number | null} y
 * @property {string} author
 * @property {boolean} guest
 * @property {string} text
 * @property {number} created unix seconds
 * @property {number | null} resolved likewise; null: open
 * @property {string | null} resolved_by
 * @property {boolean} resolved_guest whether that was a guest of a share link
 *
 * @typedef {object} Take a saved camera with the settings of a scene's live view
 * @property {string} id
 * @property {string} name
 * @property {string | null} author null: unknown
 * @property {number} created unix seconds
 * @property {Record<string, any>} request the view as a job's request
 * @property {number} exposure in stops
 * @property {string} tonemap
 * @property {string | null} picture URL
 *
 * @typedef {object} Job
 * @property {Codes} [codes]
 * @property {string} id
 * @property {string} name
 * @property {string} scene
 * @property {string} [project] its scene's; empty: none
 * @property {JobState} state
 * @property {string | null} message why it does not progress
 * @property {boolean} [stranded] no connected worker is of the kind that started it
 * @property {string | null} error
 * @property {string | null} reproduce a command that reproduces the error
 * @property {number} [as_of] when this was true, unix seconds; of two descriptions the smaller one is older
 * @property {number} progress 0..1
 * @property {number | null} eta_s
 * @property {number} active_s rendering time without pauses
 * @property {number} elapsed_s active_s, and for a finished still the time of its last denoising
 * @property {number} samples in the film, over all pixels and frames
 * @property {number} samples_per_s current speed; 0 while not rendered
 * @property {number} bad_samples number of discarded samples (NaN or infinite)
 * @property {Frame[]} [frames] the only one of a still, the first of a shot
 * @property {Shot | null} [shot] null: a still
 * @property {number} priority -100 to 100
 * @property {number} created unix seconds
 * @property {number | null} [finished] likewise
 * @property {number | null} width null until the scene is ready, if the request leaves it to the scene
 * @property {number | null} height
 * @property {number | null} spp at most
 * @property {number | null} noise
 * @property {number | null} seconds
 * @property {number | null} [tile_size]
 * @property {[number, number, number, number] | null} [focus] rectangle that is rendered first: x, y, w, h
 * @property {Record<string, any> | null} settings
 * @property {EnvironmentRequest | null} [environment] as requested
 * @property {string | null} [variant] as requested
 * @property {string | null} [up] likewise
 * @property {string | null} [floor] likewise
 * @property {number} [exposure] of the page's display, in stops
 * @property {string} [tonemap] likewise
 * @property {boolean} [denoise] shown denoised first, once it is finished
 * @property {boolean} [pinned] exempt from retention rules
 * @property {string | null} [note] a user's note
 * @property {Review | null} [review] null: neither notes nor a verdict
 * @property {string | null} [user] its owner
 * @property {number | null} [max_slots] maximum number of slots at once
 * @property {string[]} [needs] requirements on its workers
 * @property {number | null} [deadline] unix seconds
 * @property {number | null} [expected] expected completion, if it has a deadline
 * @property {string | null} [unforeseen] why there is no forecast
 * @property {number | null} [late] since when it is expected to miss the deadline
 * @property {Wait[]} [waits_for] its unfinished dependencies
 * @property {string[]} [doubted] distrusted workers whose samples its picture contains
 * @property {{job: string, spp: number, samples?: number | null, frames?: string | null} | null} [taken] samples reused from an
 *     earlier job of the same picture; frames: the reused frames of a shot
 *
 * @typedef {{id: string, name: string | null, state: JobState | null}} Wait name and state: null if it was deleted
 *
 * @typedef {"queued" | "preparing" | "running" | "finished" | "failed"} FrameState
 *
 * @typedef {object} Frame one picture of a job
 * @property {Codes} [codes]
 * @property {number} number in steps of a half
 * @property {FrameState} state
 * @property {number} samples over all pixels
 * @property {number} spp mean samples per pixel
 * @property {number} progress 0..1
 * @property {number | null} noise relative
 * @property {string | null} error
 * @property {boolean} [denoised] whether a denoised picture is stored; of a shot, only the first frame states it
 * @property {{x: number, y: number, sample: number, reproduce?: string}[]} [bad] the first discarded samples
 *
 * @typedef {object} Shot
 * @property {string} frames frame range, such as 0-99,120
 * @property {number} count
 * @property {number | null} fps null: the scene file's own, else 24
 * @property {string | null} clip
 * @property {number | null} turntable seconds
 * @property {string} order
 * @property {number} every
 * @property {number | null} first the frame that is rendered first
 * @property {Partial<Record<FrameState, number>>} states number of frames in each state
 * @property {string} failed which
 * @property {number | null} noise maximum over its frames
 * @property {number | null} forecast
 *
 * @typedef {object} EnvironmentRequest
 * @property {number} [strength]
 * @property {number} [rotation] degrees
 * @property {Vec3} [color] linear Rec.709
 * @property {{elevation: number, azimuth?: number}} [sky] degrees
 * @property {string} [preset] by name
 * @property {string} [image] an uploaded one's id
 * @property {string | null} [name] its name
 *
 * @typedef {object} Environment an available environment
 * @property {string} id
 * @property {string} name
 * @property {string} help
 * @property {"preset" | "image"} kind
 * @property {EnvironmentRequest} environment the request for it
 * @property {string} thumbnail URL
 *
 * @typedef {object} Reference an uploaded picture for comparison
 * @property {string} id
 * @property {string} name
 * @property {number} created unix seconds
 * @property {number} bytes
 * @property {number} width
 * @property {number} height
 * @property {boolean} display_referred 8 bits per channel, display-referred
 * @property {number} clipped number of clipped pixels
 *
 * @typedef {object} Snapshot an intermediate picture of a job
 * @property {number} spp samples per pixel of every tile that is not complete with fewer
 * @property {number} least minimum samples per pixel over the tiles
 * @property {number} most
 * @property {number} samples over all pixels
 * @property {number} seconds of rendering time so far
 * @property {number | null} noise relative
 *
 * @typedef {Record<string, any> & Asked} JobRequest and any settings; the scene file's own if left out
 *
 * @typedef {object} Asked
 * @property {string} scene
 * @property {string} [variant] by number; empty: the file's own materials
 * @property {string} [up] the axis that is up, or "auto"
 * @property {string} [floor] "on", "off" or "auto"
 * @property {boolean} [denoise]
 * @property {number} [exposure] in stops
 * @property {string} [tonemap]
 * @property {string | number} [camera] by its name, or by its number
 * @property {View} [view]
 * @property {string} [name]
 * @property {number} [priority]
 * @property {number} [width]
 * @property {number} [height]
 * @property {number} [spp]
 * @property {number} [noise] relative
 * @property {number} [seconds]
 * @property {EnvironmentRequest} [environment] replaces the scene's own, or scales its strength
 * @property {number} [frame] frame number of a still
 * @property {string} [frames] of a shot
 * @property {boolean} [fresh] without reuse of earlier jobs' samples
 * @property {string | null} [deadline] an ISO time
 * @property {number | null} [max_slots] maximum number of slots at once
 * @property {string[]} [needs] requirements on its workers
 * @property {string[]} [after] ids of the jobs that it waits for
 * @property {number} [verify] fraction of its batches rendered twice
 *
 * @typedef {object} Worker
 * @property {Codes} [codes]
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
 * @property {Card[]} [cards] graphics cards with which its slots render
 * @property {string[]} [cards_unused] why other cards are not used
 * @property {string} [transport] how it reaches the queue: redis or https
 * @property {Offer | null} [offer] null: of an older release, which can only be paused
 * @property {number[]} [speeds] samples a second of all its slots, a minute each
 *
 * @typedef {object} Card
 * @property {number} number
 * @property {string} name
 * @property {number} memory bytes
 * @property {number} slot index in `current`
 * @property {number} samples_per_s 0: none yet
 *
 * @typedef {object} Offer what a worker offers
 * @property {Codes} [codes]
 * @property {string[]} tags
 * @property {number} memory bytes that it may use
 * @property {number} slots_most number at its start
 * @property {string} hours empty: always
 * @property {number} idle_minutes
 * @property {string[]} idle_by how it detects a user at its machine
 * @property {number} nice
 * @property {number} memory_limit bytes; 0: none
 * @property {string | null} rests why its own hours or limits prevent work now
 * @property {string | null} trouble terms that it cannot apply
 *
 * @typedef {{name: string, label: string, help: string}} Choice
 *
 * @typedef {object} Setting
 * @property {string} name
 * @property {string} label
 * @property {string} help a sentence
 * @property {"integer" | "number" | "choice" | "names" | "color" | "vector"} type
 * @property {any} default null if there is none
 * @property {number | null} minimum
 * @property {number | null} maximum
 * @property {{value: number | null, label: string} | null} off the value that disables it, and its label
 * @property {"" | "px" | "°" | "s" | "fraction" | "scene units" | "radiance"} unit
 * @property {Choice[] | null} choices
 * @property {"basic" | "advanced" | "lab"} group
 * @property {string} section section of the form
 * @property {"job" | "environment"} of the part of a request that it belongs to
 * @property {string[] | null} integrators that use it; null: all
 * @property {string[] | null} projections that use it; null: all
 * @property {[number, number] | null} [usual] the usual range, for a slider
 * @property {string} phrase names a picture by the value, in place of {}
 *
 * @typedef {object} Channel
 * @property {string} name "" for the light as it is; else the service's name of the plane, or DENOISED
 * @property {string} label
 * @property {string} help
 * @property {string[]} values the names of a pixel's numbers
 *
 * @typedef {{name: string, display: string, view: string, is_default: boolean}} DisplayView of an OpenColorIO config; is_default: its display is the config's default
 *
 * @typedef {{defaults: {width: number, height: number, spp: number}, settings: Setting[], view: Setting[], work: Setting[], shot: Setting[], channels: Channel[], version?: string, views?: DisplayView[]}} SettingsTable
 *
 * @typedef {{name: string, title: string, description: string, frames: string | null, fps: number | null, scenes: string[]}} Example scenes: ids of those opened from it
 *
 * @typedef {[number, number, number]} Spot x, y, w: visible at x / w, y / w of the picture if w > 0
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
 * @typedef {object} FrameWorkers who rendered the samples of a frame; numbers of a tile are per pixel, of others over all pixels
 * @property {{name: string, samples: number}[]} workers
 * @property {number} unknown
 * @property {{x: number, y: number, w: number, h: number, samples: number, shares: number[]}[]} tiles shares: in the order of `workers`
 *
 * @typedef {{x: number, y: number, frame: number, samples: number, mean: number[] | null, equals_film: boolean | null, worker: string | null, paths: PixelPath[]}} Explained
 *
 * @typedef {Record<string, any> & {samples: number, lights?: Record<string, number[]> | null}} PixelValue by channel, `color` being the light
 */

export {};
