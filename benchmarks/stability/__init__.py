"""The suite `stability`: where each solver breaks, and how.

Every row below is a way in which contact solvers fail, known from their own papers, manuals and issues. Those that a
stacked system can show are ladders of this suite, one row of a table each; the others say why they are not.

====  ========================================  ==================================================================
F1    sweeps slow on tall stacks                `column`
F2    mass ratio                                `mass-ratio`
F3    redundant contacts                        `deck`
F4    conditioning of stacks                    `tower`
F5    self-stress: several exact solutions      `walls`
F6    convex relaxation opens sliding contacts  `glide`
F7    friction that lags behind                 `landing`
F8    anisotropic pyramids and boxes            `heading`
F9    scalar sweeps stick inside a cone         `rough`
F10   regularised friction creeps               `edge-held`, `edge-sliding`
F11   a post-pass against slip                  none: no solver here has one, and no setting of a peer turns it on
F12   Painlevé                                  `painleve`
F13   infeasible, jammed                        `jam`
F14   pivots: cycling, exponential, wrong       `fathi`
F15   ill-conditioned QP                        `condition`
F16   restitution with friction gains energy    none: a property of the impact law, not of a solver; suite `impacts`
F17   cradle as one system                      `cradle`; break-away is again the law's, suite `impacts`
F18   restitution at rest                       `elastic-rest`
F19   restitution corner by corner              `small-base`
F20   bounces that gain or lose height          `bouncing`
F21   overlap that pops                         `overlap`
F22   drift, and steps of other lengths         `time-step`, `short-step`
F23   arch, house of cards                      `arch`, `cards`
F24   fake solutions of interior points         `coupled`, `random`; the problem that it was seen on is not at hand
F25   residual with units                       `units`
F26   penalties that depend on scale            `density`
F27   A that is not symmetric                   none: A = J M⁻¹ Jᵀ is symmetric, and another one is refused
F28   over-relaxation                           `relaxation`
F29   order of contacts                         `order`
F30   a step of the projection that is one      `units`
F31   much slides, and little is determined     `struck`
====  ========================================  ==================================================================

No ladder has joints, motors, rolling friction or soft bodies, as the library has none.
"""
